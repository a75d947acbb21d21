"""How a program that was played ends, in words that both sides of an action and a bag know."""

COMPLETED = "completed"
CANCELLED = "cancelled"
