"""The fleet server: collector, alarms, routes, commands.

Begin with fleet_server.py. Imports all rooms of the fleet but robot.
"""
