"""Who plays a game without learning from it: people, random actions, trained policies."""
