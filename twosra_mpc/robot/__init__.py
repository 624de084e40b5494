"""The robot as data: geometry, path model, limits, heater, segments; modes of stiffness."""
