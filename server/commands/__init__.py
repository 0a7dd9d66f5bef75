"""The commands of the command line, one file each; arguments.py has their options."""
