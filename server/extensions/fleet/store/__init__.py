"""The store of a fleet: tables of samples, packets and recordings as Parquet in any object store. Begin with store.py.
Imports model and tunnel.
"""
