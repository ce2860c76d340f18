"""What stands in the way of a landing: devices opened and measured, one finding for each fact.

Nothing here sends the vehicle anywhere. The gimbal is moved, but not while the vehicle is armed.
"""
