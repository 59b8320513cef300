"""From joints to frames and back: closed forms where there are any, and the joints along a whole path."""
