"""Rules that hold for the whole project: rooms and arrows, English, names, errors, licences, number of lines."""
