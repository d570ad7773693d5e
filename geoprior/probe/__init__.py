"""Measures of a prior, from seconds to minutes: does it look, and does it know where the object is?"""
