"""Files and texts that several rooms read or write. Imports core only."""
