"""The Xerxes direct-drive mount's UDP protocol: datagrams, and the client's session."""
