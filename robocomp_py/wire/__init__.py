"""Values to bytes and back, headers, and the names under which messages travel."""
