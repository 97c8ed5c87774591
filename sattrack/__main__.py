"""Run the command line as `python -m sattrack`."""

from sattrack.core.process import end_with_starter

if __name__ == "__main__":
    # Before the long imports: who started it may be gone already.
    end_with_starter()
    from sattrack.cli.main import main

    main()
