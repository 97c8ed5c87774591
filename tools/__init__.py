"""What keeps documents and other people's tools in step with the code; not part of the installed packages."""
