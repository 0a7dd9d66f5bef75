"""The library of recordings: index, files, previews, quota, downloads. Begin with library.py. May import all of
recordings but the exporters.
"""
