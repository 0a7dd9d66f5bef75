"""Conversation with a device: transactions, the driver that a family offers, composed frames. Begin with
transactions.py. Knows schema and events, no family.
"""
