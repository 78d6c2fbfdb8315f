"""Pictures of the pages in headless Chromium (`make screenshots`)."""
