"""What has been recorded: every run below a folder, how it ended, and what its diagnosis said."""
