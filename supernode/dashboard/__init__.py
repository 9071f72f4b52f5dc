"""The dashboard: a cluster in a browser. A process of its own and a client like any other, so it slows nobody down."""
