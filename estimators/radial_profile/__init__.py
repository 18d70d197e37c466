"""A pipe of any smooth profile as a radius over angle and depth (radius paper, eq. 17): the wall that stereo should see.

Not to be confused with ``estimators.profile``, the cross-section that the diameter survey reads from one depth picture.
"""
