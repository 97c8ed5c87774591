"""Terminal screens: they see `sattrack.view`, send `sattrack.messages`, and hold no tracking logic."""
