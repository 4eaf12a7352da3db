"""The matcher of watched patterns: view lifecycle, lookups in views, and notification of subscribers."""
