"""Recordings: folders of frames and force logs; import, labels and export."""
