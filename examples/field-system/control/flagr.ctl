* How often flagr looks whether the antenna is on source, hundredths of a second.
 200
