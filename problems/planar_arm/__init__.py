"""What the planners of planar arms share: arm-ik and arm-path."""
