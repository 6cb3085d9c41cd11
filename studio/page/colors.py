"""Colours that several drawings share."""

#: Of bodies that collide: dark orange, told apart from blue and grey by everybody.
HIT_COLOR = (213, 94, 0)
