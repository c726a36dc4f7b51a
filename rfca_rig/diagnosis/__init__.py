"""Says where model and recordings part, which physics was left out, and how sure that is."""
