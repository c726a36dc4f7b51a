"""A run, or any recording, in the browser. Entry points: `live_view.LiveView` and `replaying`.

A run puts what it sees into `run_queue`; a process of its own (`process`) takes it out in `live_source` and serves pages (`server`).
`replay` plays recordings through the same `page_feed`.
"""
