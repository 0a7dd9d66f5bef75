"""Plug-ins in packages of their own: families, extensions, readers, links, exporters and analyses."""
