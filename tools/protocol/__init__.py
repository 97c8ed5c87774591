"""The generated parts of docs/xerxes-protocol.md, its pictures, and the Wireshark dissector's field table."""
