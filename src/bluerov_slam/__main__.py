"""`python -m bluerov_slam` is the `bluerov-slam` command."""

from bluerov_slam.cli.main import main

main()
