"""What is made of the code for people to read or load: pages of docs/, files of ardupilot/.

`python -m landerd.reference` writes all of them into a checkout (make reference).
"""
