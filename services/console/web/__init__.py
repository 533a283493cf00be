"""HTTP and WebSocket: how pages come to browsers, and browsers' wishes to pages."""
