"""Parts of drive_campus."""
