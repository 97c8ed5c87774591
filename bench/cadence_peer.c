/* The least that a loop can be: one datagram at each absolute deadline. cadence.py builds and runs it.
 *
 * cadence_peer PORT SECONDS PERIOD_NS PRIORITY
 *
 * PRIORITY 0 leaves the scheduling as it is, others ask for SCHED_FIFO; exit code 3 where that is refused.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <sched.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>

enum { COMMAND_BYTES = 82, REFUSED = 3 };

int main(int count, char **arguments)
{
    if (count != 5)
        return 2;
    const long period_ns = atol(arguments[3]);
    const long turns = (long)(atof(arguments[2]) * 1e9 / (double)period_ns);
    const struct sched_param priority = { .sched_priority = atoi(arguments[4]) };
    if (priority.sched_priority > 0) {
        if (sched_setscheduler(0, SCHED_FIFO, &priority) != 0)
            return REFUSED;
        mlockall(MCL_CURRENT | MCL_FUTURE);
    }
    const struct sockaddr_in peer = {
        .sin_family = AF_INET,
        .sin_port = htons((unsigned short)atoi(arguments[1])),
        .sin_addr = { .s_addr = htonl(INADDR_LOOPBACK) },
    };
    const char datagram[COMMAND_BYTES] = { 0 };
    const int link = socket(AF_INET, SOCK_DGRAM, 0);
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long turn = 0; turn < turns; turn++) {
        due.tv_nsec += period_ns;
        while (due.tv_nsec >= 1000000000L) {
            due.tv_nsec -= 1000000000L;
            due.tv_sec++;
        }
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR)
            ;
        sendto(link, datagram, sizeof datagram, 0, (const struct sockaddr *)&peer, sizeof peer);
    }
    return 0;
}
