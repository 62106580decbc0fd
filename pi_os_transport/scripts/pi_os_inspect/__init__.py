"""Looks into the nodes of this device that run with π-OS: their links, services, pools, and why what is on TCPROS."""
