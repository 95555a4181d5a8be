"""The evaluation of Remmerswaal et al. 2021 by simulation."""
