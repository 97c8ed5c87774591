* No programs of the station's own besides antcn.
