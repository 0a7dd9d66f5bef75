"""Readers of files of other programs, against files that these programs' own libraries write."""
