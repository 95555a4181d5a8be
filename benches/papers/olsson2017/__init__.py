"""The evaluation of Olsson & Halvorsen 2017 by simulation."""
