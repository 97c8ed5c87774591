* The computer's own clock, which something else keeps right: rate, span, model.
 0.000 1.000 computer
