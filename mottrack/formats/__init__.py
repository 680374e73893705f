"""File formats that several rooms read. Imports core only."""
