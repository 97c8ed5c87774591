"""An equatorial ASCOM Alpaca telescope with MoveAxis as a mount to be driven.

The Xerxes protocol was made so that an ASCOM driver could stand on it, and what it says maps one to one onto
Alpaca's telescope. So a gateway, a process of its own, stands between: towards the session it is a mount that
takes 82-byte commands and gives 160-byte statuses on loopback; towards the telescope it is an Alpaca client
that polls. Calibration, tracking, safety, guardian, recording and servers are then the same for both kinds.
"""
