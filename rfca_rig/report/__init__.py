"""Reports of recordings against the model: a page for people, tables for programs and papers."""
