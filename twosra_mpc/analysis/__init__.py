"""What a plan says beyond itself: why it is so, what others would cost, how models differ."""
