/* antcn: a station's antenna program for version 10 of the Field System.
 *
 * It speaks the antenna interface of docs/antenna-interface.md to a controller, such as
 * `sattrack serve antenna --axes azel`. The antenna's line of dev.ctl says where: HOST:PORT.
 * Sources go to the controller as coordinates, satellites as elements; it reduces and follows them itself.
 * The Field System's own angles are radians, the controller's degrees.
 */

#include <math.h>
#include <netdb.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "params.h"
#include "fs_types.h"
#include "fscom.h"
#include "shm_addr.h"

/* From the Field System's libraries; its headers do not declare them. */
void setup_ids(void), putpname(char *), skd_wait(char *, int *, unsigned), logit(char *, int, char *);
void rte_time(int *, int *), rte2secs(int *, int *), cls_snd(int *, char *, int, int, int);
void cnvrt(int, double, double, double *, double *, int *, double, double);
int cls_rcv(int, char *, int, int *, int *, int, int), dad_pid(void);

/* What the Field System calls for, in ip[0]. */
enum { INITIALISE, SOURCE, OFFSETS, ONSOURCE, DIRECT, ONSOURCE_QUIETLY, TRACK = 7, SATELLITE = 9, TERMINATE };

/* Its errors of AN, in ip[2]; 1 is none of them. */
enum { OK = 0, NO_SUCH_MODE = -1, NO_ANSWER = -2, GARBLED = -3, IN_LOCAL = -4, REFUSED = -5 };

enum { ANSWER_MS = 500, SILENCE_MS = 50, MONITOR_CS = 100, LONGEST = 256, NAK_LOCAL = 8, NAK_STOWED = 10 };

typedef struct {
    double commanded_deg[2], actual_deg[2];
    int heard, designated, tracking;
} Position;

static int line = -1;
static int silent; /* whether the controller failed to answer the last time */

static double degrees(double radians) { return radians * 180.0 / M_PI; }

static void hang_up(void) {
    if (line >= 0)
        close(line);
    line = -1;
}

/* Drop what is half said on either side: the synchronisation character, then silence. */
static void synchronise(void) {
    char dropped[LONGEST];
    struct pollfd heard = {line, POLLIN, 0};
    if (send(line, "#", 1, MSG_NOSIGNAL) != 1)
        hang_up();
    while (line >= 0 && poll(&heard, 1, SILENCE_MS) > 0)
        if (recv(line, dropped, sizeof dropped, 0) <= 0)
            hang_up();
}

static int dial(void) {
    char name[sizeof shm_addr->idevant + 1] = "", *port;
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *found, *at;
    struct timeval patience = {1, 0};
    memcpy(name, shm_addr->idevant, sizeof shm_addr->idevant);
    name[strcspn(name, " ")] = '\0';
    if (!(port = strrchr(name, ':')))
        return NO_ANSWER;
    *port++ = '\0';
    if (getaddrinfo(name, port, &hints, &found))
        return NO_ANSWER;
    for (at = found; at && line < 0; at = at->ai_next) {
        line = socket(at->ai_family, at->ai_socktype, at->ai_protocol);
        setsockopt(line, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
        if (connect(line, at->ai_addr, at->ai_addrlen))
            hang_up();
    }
    freeaddrinfo(found);
    if (line >= 0)
        synchronise();
    return line < 0 ? NO_ANSWER : OK;
}

static unsigned sum(const char *text) {
    unsigned total = 0;
    while (*text)
        total += (unsigned char)*text++;
    return total & 0xff;
}

/* Send a command, and receive its response without its check. */
static int transact(const char *command, char response[LONGEST]) {
    char sent[LONGEST + 8], stated[3];
    struct pollfd heard = {line, POLLIN, 0};
    int length = 0, received;
    if (line < 0 && dial())
        return NO_ANSWER;
    heard.fd = line;
    snprintf(sent, sizeof sent, "%s ", command);
    snprintf(sent + strlen(sent), 4, "%02X\n", sum(sent));
    if (send(line, sent, strlen(sent), MSG_NOSIGNAL) != (ssize_t)strlen(sent)) {
        hang_up();
        return NO_ANSWER;
    }
    do {
        if (length == LONGEST - 1 || poll(&heard, 1, ANSWER_MS) <= 0) {
            synchronise();
            return NO_ANSWER;
        }
        if ((received = recv(line, response + length, LONGEST - 1 - length, 0)) <= 0) {
            hang_up();
            return NO_ANSWER;
        }
        length += received;
    } while (response[length - 1] != '\n');
    if (length < 4)
        return GARBLED;
    response[length - 1] = '\0';
    memcpy(stated, response + length - 3, 3);
    response[length - 3] = '\0';
    if (strtoul(stated, NULL, 16) != sum(response))
        return GARBLED;
    response[length - 4] = '\0';
    return OK;
}

/* Send a command that is acknowledged, or refused; what is refused goes to the log, with the reason's number. */
static int command(const char *format, ...) {
    char text[LONGEST], response[LONGEST], said[2 * LONGEST], *refusal;
    va_list fields;
    int failed, why;
    va_start(fields, format);
    vsnprintf(text, sizeof text, format, fields);
    va_end(fields);
    if ((failed = transact(text, response)))
        return failed;
    if (!(refusal = strstr(response, " NAK ")))
        return OK;
    why = atoi(refusal + 5);
    if (why == NAK_STOWED && !command("UNSTOW"))
        return command("%s", text);
    snprintf(said, sizeof said, "refused with %d: %s", why, text);
    logit(said, 0, NULL);
    return why == NAK_LOCAL ? IN_LOCAL : REFUSED;
}

/* The fields of a response to PS are in docs/antenna-interface.md. */
static int position(Position *now) {
    char response[LONGEST], *fields[14], *field;
    int failed = transact("PS", response), count = 0;
    if (failed)
        return failed;
    for (field = strtok(response, " "); field && count < 14; field = strtok(NULL, " "))
        fields[count++] = field;
    if (count < 14)
        return GARBLED;
    now->heard = strcmp(fields[3], ",,") != 0;
    now->designated = strcmp(fields[1], ",,") != 0;
    now->tracking = !strcmp(fields[13], "TRACKING");
    for (count = 0; count < 2; count++) {
        now->commanded_deg[count] = atof(fields[1 + count]);
        now->actual_deg[count] = atof(fields[3 + count]);
    }
    return OK;
}

static int named(const char *name) {
    return !strncmp(shm_addr->lsorna, name, strlen(name)) && shm_addr->lsorna[strlen(name)] == ' ';
}

static int source(void) {
    const char *places[] = {"boresight", "setup", "track", "hold", "xy", "azeluncr"};
    unsigned place;
    if (named("stow"))
        return command("STOW");
    if (named("service"))
        return command("SERVICE");
    if (named("idle") || named("disable"))
        return command("STOP");
    if (named("azel"))
        return command("FIXED %.6f %.6f", degrees(shm_addr->ra50), degrees(shm_addr->dec50));
    for (place = 0; place < sizeof places / sizeof *places; place++)
        if (named(places[place]))
            return NO_SUCH_MODE;
    if (shm_addr->ep1950 == 2000.0)
        return command("RADEC J2000 %.8f %.8f", degrees(shm_addr->ra50), degrees(shm_addr->dec50));
    return command("RADEC DATE %.8f %.8f", degrees(shm_addr->radat), degrees(shm_addr->decdat));
}

static int offsets(void) {
    int failed;
    if (shm_addr->XOFF != 0.0 || shm_addr->YOFF != 0.0)
        return NO_SUCH_MODE;
    failed = command("OFFSET RADEC %.7f %.7f", degrees(shm_addr->RAOFF), degrees(shm_addr->DECOFF));
    return failed ? failed : command("OFFSET AZEL %.7f %.7f", degrees(shm_addr->AZOFF), degrees(shm_addr->ELOFF));
}

/* The elements go again at each call: nothing else tells a new satellite from a new offset. */
static int satellite(void) {
    struct satellite_cmd *sat = &shm_addr->satellite;
    struct satoff_cmd *off = &shm_addr->satoff;
    int number = atoi(sat->tle1 + 2), failed;
    if (sat->mode != 0 || sat->satellite != 1)
        return NO_SUCH_MODE;
    failed = command("SATOFF %.2f %.6f %s", off->seconds, degrees(off->cross), off->hold ? "HOLD" : "TRACK");
    if (!failed)
        failed = command("TLE 0 %d %.24s", number, sat->tle0);
    if (!failed)
        failed = command("TLE 1 %d %.69s", number, sat->tle1);
    if (!failed)
        failed = command("TLE 2 %d %.69s", number, sat->tle2);
    return failed ? failed : command("SAT %d", number);
}

/* Say how the antenna stands to what was commanded; `word` begins what is said. */
static void describe(const char *word, const Position *now) {
    const double *is = now->actual_deg, *wanted = now->commanded_deg;
    char said[LONGEST];
    if (!now->heard)
        snprintf(said, sizeof said, "%s the controller does not hear the mount", word);
    else if (!now->designated)
        snprintf(said, sizeof said, "%s nothing is followed, at %.4f %.4f", word, is[0], is[1]);
    else
        snprintf(said, sizeof said, "%s %.4f %.4f %.4f %.4f", word, wanted[0], wanted[1], wanted[0] - is[0],
                 wanted[1] - is[1]);
    logit(said, 0, NULL);
}

static int onsource(int tell) {
    Position now;
    int failed = position(&now);
    shm_addr->ionsor = !failed && now.tracking;
    if (!failed && tell && !now.tracking)
        describe("off", &now);
    return failed;
}

/* Where the Field System's own arithmetic has what was commanded, degrees; 0 where it has nothing. */
static int predicted(double place_deg[2]) {
    int it[6], seconds, entry;
    double az, el, part;
    rte_time(it, it + 5);
    rte2secs(it, &seconds);
    if (shm_addr->satellite.satellite == 1) {
        entry = seconds - shm_addr->ephem[0].t;
        if (entry < 0 || entry + 1 >= MAX_EPHEM)
            return 0;
        part = it[0] / 100.0;
        az = remainder(shm_addr->ephem[entry + 1].az - shm_addr->ephem[entry].az, 2.0 * M_PI);
        az = shm_addr->ephem[entry].az + part * az;
        el = shm_addr->ephem[entry].el + part * (shm_addr->ephem[entry + 1].el - shm_addr->ephem[entry].el);
    } else if (shm_addr->ep1950 > 0.0) {
        cnvrt(1, shm_addr->radat, shm_addr->decdat, &az, &el, it, shm_addr->alat, shm_addr->wlong);
    } else
        return 0;
    place_deg[0] = degrees(az);
    place_deg[1] = degrees(el);
    return 1;
}

/* Commanded place and its difference from the actual one, then the Field System's own prediction, degrees. */
static int track(void) {
    Position now;
    double place_deg[2];
    char said[LONGEST];
    int failed = position(&now);
    shm_addr->ionsor = !failed && now.tracking;
    if (failed)
        return failed;
    describe("tr", &now);
    if (predicted(place_deg)) {
        snprintf(said, sizeof said, "pr %.4f %.4f", place_deg[0], place_deg[1]);
        logit(said, 0, NULL);
    }
    return OK;
}

/* `antenna=`: the controller's commands as they are, and its responses. */
static int direct(int *ip) {
    char text[LONGEST], response[LONGEST];
    int class = ip[1], records = ip[2], replies = 0, failed = OK, length, unused;
    ip[0] = ip[1] = 0;
    for (; class && records > 0; records--) {
        length = cls_rcv(class, text, sizeof text - 1, &unused, &unused, 0, 0);
        text[length < 0 ? 0 : length] = '\0';
        if ((failed = transact(text, response)))
            continue;
        cls_snd(&ip[0], response, strlen(response), 0, 0);
        ip[1] = ++replies;
    }
    return failed;
}

/* Once a second, while nothing else is asked for: the line is alive, and the log says when it dies. */
static void monitor(void) {
    Position now;
    int failed = position(&now) == NO_ANSWER;
    if (failed != silent)
        logit(failed ? "the antenna does not answer" : "the antenna answers", 0, NULL);
    silent = failed;
}

static int called(int mode) {
    switch (mode) {
    case INITIALISE: /* an error here would end the Field System: it may start before its antenna does */
        shm_addr->ionsor = 0;
        monitor();
        return OK;
    case SOURCE:
        return source();
    case OFFSETS:
        return offsets();
    case ONSOURCE:
        return onsource(1);
    case ONSOURCE_QUIETLY:
        return onsource(0);
    case TRACK:
        return track();
    case SATELLITE:
        shm_addr->ionsor = 0;
        return satellite();
    case TERMINATE:
        return command("STOP");
    default:
        return NO_SUCH_MODE;
    }
}

int main(void) {
    int ip[5] = {0};
    setup_ids();
    putpname("antcn");
    for (;;) {
        skd_wait("antcn", ip, MONITOR_CS);
        if (dad_pid() == 0 && ip[0] == 0) {
            monitor();
            continue;
        }
        if (ip[0] == DIRECT)
            ip[2] = direct(ip);
        else {
            ip[2] = called(ip[0]);
            ip[0] = ip[1] = 0;
        }
        memcpy(ip + 3, "AN", 2);
        ip[4] = 0;
    }
}
