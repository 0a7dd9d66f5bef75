"""Questions to the store, in prepared queries and in SQL, answered in a process of their own. Begin with
query_service.py. Imports model and store.
"""
