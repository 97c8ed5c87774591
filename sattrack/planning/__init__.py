"""What a pass will ask of the mount, known before it: rehearsal, keyhole, sides of the pier, error budget."""
