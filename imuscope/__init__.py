"""imuscope: inertial sensors in a browser.

The folders of this package are links to those at the top level of the source: imuscope.server is server/. Nothing
imports the bare names, which are too common: a robot has a `server` of its own.
"""
