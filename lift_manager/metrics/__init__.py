"""Metrics of a running manager, for Prometheus."""
