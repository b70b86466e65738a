"""Monte-Carlo over the whole sky: how often an identifier is right, and how long it takes.

Its panoramas are made from a list of stars, without a port. May not import sessions or cli.
"""
