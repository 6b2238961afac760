"""What fusing brings, what each sensor contributes, which one disagrees, and what happens when one fails."""
