"""Fleet server: collector, alarms, routes, commands. Begin with fleet_server.py. Imports all rooms but robot."""
