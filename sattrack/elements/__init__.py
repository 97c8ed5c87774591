"""Element sets from the network, kept with their age."""
