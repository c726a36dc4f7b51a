"""How large and how readable the package is, counted; its limits are a test."""
