"""The Field System's antenna interface: the controller's side, and the side of `antcn`, which drives one."""
