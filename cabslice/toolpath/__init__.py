"""The lines the nozzle follows, in order, with the filament they take. No time in here."""
