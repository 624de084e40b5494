"""Plans and robots in the formats of other programs: bags of ROS 2 (MCAP), URDF."""
