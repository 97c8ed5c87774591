* No rack, no recorders, no decoder.
none
none
none
none
* What belongs to equipment that is not there must be given all the same.
500.10
0
a/d
101
60
20
none
40
1
in
8bit
cdp
off
return
v107
v15_1
1 1 1 1
15000 15000 15000 15000
none
vsi1-2
