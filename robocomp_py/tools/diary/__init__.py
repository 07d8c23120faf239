"""Diaries of components: all that enters the code of a component and all that leaves it, to run the code again."""
