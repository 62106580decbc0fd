"""pi_edge fleet: keys, certificates and configuration of a fleet whose sites and vehicles meet over NATS."""
