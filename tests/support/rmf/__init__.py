"""Models of Open-RMF's own programs, and a small world in which they meet the adapter."""
