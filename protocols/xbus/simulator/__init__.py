"""Simulated MTi."""
