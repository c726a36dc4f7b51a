"""Recordings from elsewhere: folders of `rfca-campaign/1`, and opening whatever a user points at."""
