"""Wrappers around any controller: filters, input shapers, compensation, motor coordinates."""
