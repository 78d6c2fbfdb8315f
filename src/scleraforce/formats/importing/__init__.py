"""What a recording is imported from: what was told, what is asked, and what its import.json says."""
