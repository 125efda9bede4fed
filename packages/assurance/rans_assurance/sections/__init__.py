"""What results say, read from their JSON files: on terminals, in notebooks, reports and dossiers."""
