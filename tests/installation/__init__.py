"""Tests of landerd.installation."""
