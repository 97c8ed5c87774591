* The station: name (8 characters), longitude west and latitude north in degrees, height in metres; then its horizon.
SATTRACK
 -4.4908
 52.1541
 0.0
* azimuth, elevation, azimuth ...
0 10 360
