"""PPO and SAC, and what they learn from: rollouts and replay buffers."""
