"""The heater loop of one segment: sensor, observer, what is known of its stiffness, controller."""
