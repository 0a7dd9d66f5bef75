"""The command line's commands, one file each; server/cli.py knows their options."""
