* The antenna as its controller presents it with --axes azel: diameter in metres, slew rates in degrees a minute,
* limits in degrees, axes.
  0.5
  300.
  300.
 -0.1
 365.0
 10.0
 90.0
 azel
