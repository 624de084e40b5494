"""The paper's greedy planner: as published, and as the reference every plan is compared with."""
