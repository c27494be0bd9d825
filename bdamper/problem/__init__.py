"""A problem: settings, the bases, contact stiffness and static states made from them, and the equations at a preload."""
