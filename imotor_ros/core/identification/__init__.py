"""Identification of the friction contact by a sine of stepped amplitude, section 5 of the paper."""
