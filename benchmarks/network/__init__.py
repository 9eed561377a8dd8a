"""What an overlay costs on the network: native, host network, srprov's overlay, WireGuard, Docker Swarm's overlay."""
