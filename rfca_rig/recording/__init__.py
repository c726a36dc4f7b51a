"""The form of a recording, and how it is kept on disk."""
