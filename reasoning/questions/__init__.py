"""Questions to annotated logs: tables, SQL, ready questions, patterns."""
