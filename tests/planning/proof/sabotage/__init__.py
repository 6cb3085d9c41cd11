"""Sabotage: each verdict that planners use is made to lie, and the certificate must not believe it.

``cases`` are real problems, ``lies`` the verdicts and how they lie, ``judge`` finds bad motions
with pinocchio, FCL and numpy alone, ``trial`` plans the problems under a lie and listens to what is
handed to the certificate. ``python -m tests.planning.proof.sabotage`` prints the table.
"""
