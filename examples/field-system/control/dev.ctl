* Devices: there is an antenna and nothing else. Its line is the controller's HOST:PORT.
* GPIB
/dev/null
* MAT, and its rate
/dev/null
9600
* data buffer, and its rate
/dev/null
9600
* antenna
127.0.0.1:7621
* barcode reader
/dev/null
* MCB, and its rate
/dev/null
57600
* data set, and its rate
/dev/null
38400
