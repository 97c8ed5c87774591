"""The Xerxes direct-drive mount's UDP protocol: datagrams, the client's side and the mount's side."""
