"""Terminal screens: they show views, send messages, and hold no tracking logic."""
