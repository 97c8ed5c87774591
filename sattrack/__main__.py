"""Run the command line as `python -m sattrack`."""

from sattrack.cli import main

if __name__ == "__main__":
    main()
