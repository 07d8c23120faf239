"""`rc monitor`: what runs, beside what is declared, as a picture and as a page in the browser.

`view.py` makes the picture of a look, purely; `server.py` serves the page.
"""
