"""What is done to a sweep before anyone interprets it.

Ground, ego motion, points in boxes, visibility.
"""
