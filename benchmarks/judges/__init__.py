"""Judges that share nothing with what they judge: FCL, pinocchio, numpy and IPOPT."""
