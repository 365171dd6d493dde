"""`python -m bluerov_slam`: the same as the `bluerov-slam` command."""

from bluerov_slam.cli.main import main

main()
